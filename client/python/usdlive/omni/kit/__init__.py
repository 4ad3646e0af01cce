"""Kit's `omni.kit`."""
