class TFMessage:
    pass
