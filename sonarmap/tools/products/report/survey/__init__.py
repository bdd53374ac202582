"""What the pictures of a finished map share: what is drawn, where North is, the sheet with its scales and legend."""
