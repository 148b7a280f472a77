"""Pictures of people and rooms, and what a robot's head would see of them."""
