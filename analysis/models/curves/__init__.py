"""Psychometric functions of many people: integrals, populations, fit."""
