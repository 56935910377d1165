# SPDX-License-Identifier: Apache-2.0
"""Runs print jobs on a machine: motion controller and dispenser, real or simulated.

A job is a path over time (`job`). A process of its own (`process`) follows it along one path
parameter (`executor`), drives the axes through a `motion` controller and gates the
`dispenser`; it alone decides that the dispenser is off. The ROS 2 node (`nodes`) sends it
requests (`link`) and shows what it reports; when the node dies, the process stops the axes
and shuts the dispenser by itself.
"""
