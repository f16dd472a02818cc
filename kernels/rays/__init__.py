"""The rays of a sensor: origins, directions and times of firing."""
