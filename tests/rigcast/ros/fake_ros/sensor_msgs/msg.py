class PointCloud2:
    pass


class LaserScan:
    pass


class Image:
    pass


class CameraInfo:
    pass
