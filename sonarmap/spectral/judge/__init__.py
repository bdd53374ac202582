"""What is a registration worth? How probable its place is and how sure its pose there, from all that was measured."""
