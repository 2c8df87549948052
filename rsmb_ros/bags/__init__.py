"""Recordings of every format in, .mcap out."""
