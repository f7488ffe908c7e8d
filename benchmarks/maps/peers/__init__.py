"""Whether files that other programs wrote are taken as what they are, judged by code apart from the product."""
