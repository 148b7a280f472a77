"""Entry point of `planner_node` (placeholder)."""


def main() -> None:
    """Start the node."""
    print("planner_node: not written yet")


if __name__ == "__main__":
    main()
