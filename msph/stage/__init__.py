"""Frame loop and its users: window, recorder and headless benchmark."""
