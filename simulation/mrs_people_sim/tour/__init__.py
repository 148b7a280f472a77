"""A guided tour in a simulated world, through the real processes of a team."""
