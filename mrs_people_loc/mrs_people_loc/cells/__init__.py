"""The paper's method: zones, noise windows, cells; clusters of cells of human size."""
