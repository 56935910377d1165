# SPDX-License-Identifier: Apache-2.0
"""Dispensers: simulated, digital output, Musashi serial."""
