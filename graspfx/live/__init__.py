"""A running scene that somebody looks at and steers: in a browser, or with fingers on a touch screen."""
