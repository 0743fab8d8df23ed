namespace slf {}
