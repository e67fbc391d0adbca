"""A device at the end of a wire: ports, commands with answers, live recording, and a simulated device to try them on."""
