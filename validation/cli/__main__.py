"""``python -m validation.cli``: the command line without its installed name."""

from validation.cli import main

main()
