"""What is in files of scans, before anything is made of them?

In: files, folders, patterns. Out: an `Overview`.
"""
