"""Looking at what sensors saw: in rerun, or in a page that needs nothing but a browser."""
