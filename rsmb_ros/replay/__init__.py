"""Every frame of a recording through the detector, offline: one `ReplayJob`, one `Summary`."""
