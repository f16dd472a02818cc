"""What `rigcast bench` measured, written and drawn."""
