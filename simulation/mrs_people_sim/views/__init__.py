"""What the heads see at an instant: bodies in their places, ray casting, images."""
