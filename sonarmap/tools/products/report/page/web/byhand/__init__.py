"""What the user decides in the page: ties and control points, kept by the browser and saved as CSV for `--ties` and
`--control`."""
