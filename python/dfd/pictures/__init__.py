"""What people look at: shapes, features and weights drawn, and sheets of them."""
