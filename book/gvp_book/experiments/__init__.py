"""The episodes behind each table and figure, and what is made of their rows."""
