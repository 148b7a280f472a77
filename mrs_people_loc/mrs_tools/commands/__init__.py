"""The subcommands of `mrs`, a file each."""
