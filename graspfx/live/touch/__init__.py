"""Running scenes controlled by a touch screen: goals of fingers, pictures, and the log of orders."""
