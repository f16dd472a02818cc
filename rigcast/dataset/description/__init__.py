"""The contents of a data set's file, checked when it is read."""
