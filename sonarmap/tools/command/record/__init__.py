"""Recording of a Sonar 3D-15: its packets from the network to a `.sonar` file.

In: UDP datagrams. Out: a file with the sonar's packets as they came, and counts of lost, late and damaged ones.
"""
