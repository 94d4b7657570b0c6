"""Frame loop and its users: window, recorder, measurement and headless benchmark."""
