"""Sensor physics applied to hits: light and repeatable noise here, the effects of lidars and cameras in sub-rooms."""
