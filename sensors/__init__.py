"""What a user mounts on a MuJoCo model, and what it reads. The public names are in `rigcast`."""
