"""The paper's experiment, simulated: its figures beside ours."""
