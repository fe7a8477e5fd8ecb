"""Input compartments that integrate a bias."""
