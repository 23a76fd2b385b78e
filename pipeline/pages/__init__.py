"""What the pages for people share: their style, plots as SVG, pictures as text."""
