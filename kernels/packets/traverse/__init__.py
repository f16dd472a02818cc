"""Tiles and packets on their way through trees and height fields."""
