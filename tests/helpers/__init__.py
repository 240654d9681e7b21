"""What several tests share: bytes and flights made by hand, oracles, links, viewers."""
