"""Which effects matter, what each costs, and proof that what is off is absent."""
