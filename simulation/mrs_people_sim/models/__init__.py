"""What stands in a scene, as textured triangles: rooms, furniture, people, robots."""
