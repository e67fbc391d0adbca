"""Design of the firmware's control loops: exact discrete model, margins, gains for a bandwidth, and the Bode plot measured on the twin."""
