"""Identification: synthetic logs, coverage of intervals, pictures."""
