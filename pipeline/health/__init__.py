"""What a run says of itself: what was measured, what it means for the map, and what to do."""
