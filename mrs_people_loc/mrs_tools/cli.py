"""The `mrs` command (placeholder)."""


def main() -> None:
    """Run the command."""
    print("mrs: not written yet")
