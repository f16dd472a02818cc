"""What the file of a data set says, checked at the door."""
