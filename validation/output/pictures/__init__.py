"""Pictures: how they are rendered and set, and what they show."""
