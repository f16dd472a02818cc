"""The tests of data sets."""
