def random_share(w_avg, w_slow, w_fast, alpha_slow, alpha_fast):
    w_slow = w_slow + alpha_slow * (w_avg - w_slow)
    w_fast = w_fast + alpha_fast * (w_avg - w_fast)
    share = 1.0 - w_fast / w_slow
    if share < 0.0:
        share = 0.0
    return w_slow, w_fast, share
