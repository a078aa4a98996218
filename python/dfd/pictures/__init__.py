"""Pictures for people: shapes, features and weights, and sheets of them."""
