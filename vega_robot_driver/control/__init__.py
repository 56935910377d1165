# SPDX-License-Identifier: Apache-2.0
"""Closing the axes' loops in the computer: PID with recorded disturbances fed forward."""
