"""Results of `rigcast bench` as JSON and charts."""
