"""The protocols that encoders speak over a serial line, one file each; see `base`."""
