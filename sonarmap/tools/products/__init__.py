"""What becomes of a finished map: the files of its folder, pictures and the report, exports for other programs."""
