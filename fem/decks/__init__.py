"""Input decks for other programs: stated, written for Abaqus and CalculiX, read back."""
