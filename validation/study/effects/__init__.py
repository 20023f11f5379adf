"""Which effects matter, what each costs, and that what is off is absent."""
