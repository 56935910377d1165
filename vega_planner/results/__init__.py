# SPDX-License-Identifier: Apache-2.0
"""The result folder: what a plan leaves on disk, and how it is read back."""
