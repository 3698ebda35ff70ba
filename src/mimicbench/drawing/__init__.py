"""Pictures of scenes for people: where they are drawn, from where one looks, and the light."""
