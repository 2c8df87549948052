"""The parts of the documentation that are read from the code; nothing here needs mkdocs."""
