# SPDX-License-Identifier: Apache-2.0
"""The browser viewer and the pictures of a plan."""
