"""How clouds are called."""


def count(size):
    return f"{size // 1000}k" if size % 1000 == 0 else str(size)


def cloud(shape, size, noise):
    return f"{shape}_{count(size)}_{noise:g}"
