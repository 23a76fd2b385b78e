"""What `beemap doctor` looks at, one file a subject."""
