"""Effects of depth cameras: stereo, structured light (the first Kinect), time of flight, lost pixels."""
