"""What a map gives back to the lines of pings that it was made of: corrected navigation and soundings.

In: a finished survey, and the files of its lines. Out: navigation.csv, soundings.laz and lines.json in its folder.
"""
