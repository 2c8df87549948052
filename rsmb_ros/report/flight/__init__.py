"""A whole flight on one page: `FlightReport` collects it frame by frame."""
