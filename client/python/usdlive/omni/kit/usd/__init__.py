"""Kit's `omni.kit.usd`."""
