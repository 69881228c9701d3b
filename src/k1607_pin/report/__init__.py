"""The report itself: its equations checked, its figures and numbers reproduced."""
