"""The report of a calibration: one HTML file that holds everything, and its figures as PNGs."""
