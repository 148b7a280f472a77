"""A running team, or a bag, in the browser: what `mrs view` serves."""
