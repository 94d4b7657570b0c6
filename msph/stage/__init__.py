"""Frame loop and its users: window, recorder, measurer and headless benchmark."""
