"""What generates pages of the site from models, commands and runs."""
