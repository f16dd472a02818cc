"""One picture per sensor that a person can judge at a glance."""
