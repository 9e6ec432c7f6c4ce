"""What is touched: shapes and their contact points, rigid bodies and how they move."""
