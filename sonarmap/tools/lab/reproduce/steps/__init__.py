"""Table 1 of the paper and its continuation to S12 on several scenes, by every method."""
