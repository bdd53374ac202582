"""Reader of recordings of the Sonar 3D-15: packets, messages, shots in order, and attitude from its IMU.

In: a `.sonar` file. Out: point clouds with strengths, stamps and priors, and notes on lost or damaged packets.
"""
