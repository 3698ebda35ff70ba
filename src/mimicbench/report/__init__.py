"""Tables, plots, pictures, videos and the page that shows them."""
