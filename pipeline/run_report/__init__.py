"""The report of a run: report.html, one file that holds everything."""
