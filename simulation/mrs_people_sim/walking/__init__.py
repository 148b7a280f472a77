"""How people move: groups that walk, and crowds that follow a guide."""
