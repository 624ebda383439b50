"""dampers"""
