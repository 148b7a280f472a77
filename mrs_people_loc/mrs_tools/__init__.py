"""The `mrs` command: bags, evaluation, simulation and plots."""
