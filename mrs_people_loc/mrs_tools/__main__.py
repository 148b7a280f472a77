"""`python -m mrs_tools`: the `mrs` command."""

from mrs_tools.cli import main

main()
