"""One linear problem of the static iteration, condensed or sparse."""
