"""One tick of a scene: its code, the parts that it runs over, and the text that it becomes."""
