"""What each part is worth: switched off alone, on the same cases."""
