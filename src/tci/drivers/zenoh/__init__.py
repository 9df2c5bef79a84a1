"""Driver and server for robots over the middleware Zenoh."""
