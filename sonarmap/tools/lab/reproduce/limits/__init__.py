"""How far roll, pitch and yaw can be estimated under tilt (Sect. 2.7, Figs. 7 to 9)."""
