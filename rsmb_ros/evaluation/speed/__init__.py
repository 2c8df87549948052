"""How fast: beside ECC on the same frames, beside the floor, over sizes, in a stream."""
