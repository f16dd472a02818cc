"""Views of readings: in rerun, or in a page that needs only a browser."""
