"""What every node needs: parameters, threads, services and topics of others, other heads."""
