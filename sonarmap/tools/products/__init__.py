"""Products of a finished map: the files of its folder, pictures, report, exports, sections, volumes and comparisons."""
