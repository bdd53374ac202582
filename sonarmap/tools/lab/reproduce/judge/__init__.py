"""What judging a registration is fitted to recorded evidence, and how it does on it, rule by rule."""
