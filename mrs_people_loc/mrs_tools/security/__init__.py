"""Membership of a team: certificates, tunnels, revocation."""
