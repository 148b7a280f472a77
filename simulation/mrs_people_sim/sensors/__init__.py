"""What a robot measures with: stereo heads, odometry and wheels, sonars, laser scanners."""
