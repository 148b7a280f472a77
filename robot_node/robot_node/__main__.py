"""Entry point of `robot_node` (placeholder)."""


def main() -> None:
    """Start the node."""
    print("robot_node: not written yet")


if __name__ == "__main__":
    main()
