"""What a rigid answer says: its verdict, motion, parts and rows."""
