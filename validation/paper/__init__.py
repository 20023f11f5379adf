"""The paper: its printed numbers as data, and one module for each table or figure."""
